"""User study of the paper: a page with one insertion at eleven sizes, and the evaluation of its responses."""
