"""What drivers are built of: `protocols` says what each has to do, `reader` and `line_stage` do
most of it over `ports`, `timestamps` maps a device's clock to the scan's (`clocks`), `units` and
`settings` are those of the rig file.
"""
