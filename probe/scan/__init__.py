"""A scan while it runs: `session` opens and stores it, `engine` presses at every station as
`run_loop` lets time pass, `stop_rules` end it early, `resume` goes on with one that broke off.
"""
