"""Tables that reviewers maintain: sizes, exclusions and frequencies of categories."""
