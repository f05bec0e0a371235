"""The command line: every stage of the job one by one, JSON for scripts (design.md section 9)."""
