"""Scale: from a reconstruction with instance masks to metres per scene unit."""
