"""Run the steps of a study, one or all, and save the files of each."""
