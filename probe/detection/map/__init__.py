"""What lies beneath many presses: `seen_map` and `bumps` of rows and areas, `ridge` along a vessel,
`vessel_tracking` from row to row, put together by `objects`.
"""
