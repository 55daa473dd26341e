"""How accurate the estimate is: one command writes docs/evidence/accuracy.md."""
