"""The command line.

commands        the commands
options         their arguments and options
console         exit statuses, and lines on the terminal
interrupts      Ctrl-C, SIGTERM, `--max-time`
long_runs       progress and end of long work
pictures        pictures of result files
run_summary, sweep_summary, units_report    what is printed
"""
