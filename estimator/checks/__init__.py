"""Whether a reconstruction can tell a scale at all: degenerate geometry, and a model that contradicts itself."""
