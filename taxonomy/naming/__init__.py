"""From the words of people and detectors to a node of a release: spelling, senses, modifiers."""
