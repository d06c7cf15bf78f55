"""A scan while it runs. `session` opens it, `engine` presses, `safety_monitor` and the guards
watch in a process of their own, `retreat` lifts; `preflight` asks beforehand whether it could.
"""
