"""Accuracy of the scale estimate: one command writes docs/evidence/accuracy.md."""
