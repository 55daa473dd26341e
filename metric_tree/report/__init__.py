"""What a person looks at: the HTML page of a release and contact sheets."""
