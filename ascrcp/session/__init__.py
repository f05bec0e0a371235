"""The job: state machine, worker threads, control thread, round folder, recorder, report."""
