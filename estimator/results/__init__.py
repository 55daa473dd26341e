"""From measured objects and a tree to a result: priors of the categories, scale, verdicts, advice."""
