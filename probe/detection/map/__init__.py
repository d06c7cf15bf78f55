"""What lies beneath many presses: `bumps` along a row, `field` and `ridge` over an area,
`vessel_tracking` from row to row, put together by `row_objects` and `field_objects`.
"""
