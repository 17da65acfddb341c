"""Rules being watched, one file each."""
