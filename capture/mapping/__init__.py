"""Structure from motion over chosen frames, in processes of its own, with gates that name what went wrong."""
