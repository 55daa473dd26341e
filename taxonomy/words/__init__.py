"""What words mean: folding, spelling, phrases, modifiers and senses, for a source's words and a user's alike."""
