"""The encoding of pictures: display values to linear light and back."""
