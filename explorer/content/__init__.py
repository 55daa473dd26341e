"""What pages and answers say of a release: addresses, records of JSON, flat tables, the index of names."""
