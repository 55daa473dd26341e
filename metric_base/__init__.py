"""The ground that every package stands on: faults, files, folders, terminal output."""
