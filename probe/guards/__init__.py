"""What stops a scan and lifts the probe: `safety_monitor` asks the rules of each reading,
`guarded_stage` stops and `retreat` lifts; a rig's guards have a process of their own,
`guard_process`, and `guard_client` asks it.
"""
