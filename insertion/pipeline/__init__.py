"""A request to pictures: the scene made ready, the object put in its place and drawn into every frame."""
