"""Text to labelled lengths, in seven languages; knows no page and no source."""
