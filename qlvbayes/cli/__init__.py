"""The ``qlvbayes`` command: one file for each subcommand."""
