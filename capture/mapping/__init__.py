"""Structure from motion: features, matches and a model of the chosen frames, or the reason why there is none."""
