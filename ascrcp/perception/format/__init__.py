"""One file per cloud format: each checks the header's promise against the file before it allocates."""
