"""The user study of the paper: one insertion at eleven sizes, and the report of its answers."""
