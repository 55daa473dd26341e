"""From measured objects and a tree to a result: names to priors, posterior, verdicts in words."""
