"""The command line.

commands        the commands
options         their arguments and options
console         exit statuses, and lines on the terminal
interrupts      Ctrl-C, SIGTERM, `--max-time`
long_runs       progress bars and the end of runs and sweeps
pictures        which figures of a result file are drawn by default, and drawing them
stability_words the line of `show --stability`
run_summary, sweep_summary, units_report    the text that `show` and `units` print
"""
