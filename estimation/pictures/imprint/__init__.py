"""The print that the object leaves in the picture: painted free, registered and followed."""
