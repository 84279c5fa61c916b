"""What the modules of all four packages share: files, checks, commands, versions."""
