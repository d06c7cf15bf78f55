"""The simulated world: one phantom behind a virtual stage and sensors (`devices`)."""
