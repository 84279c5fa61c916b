"""The source paper: Li, Zhou, Li, Jiang, rotation from incipient slip on a visuotactile sensor."""
