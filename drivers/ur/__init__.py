"""Universal Robots over RTDE, by the ur-rtde library in a process of its own."""
