"""The screen in the cab: draws snapshots, presses on buttons become requests to the session."""
