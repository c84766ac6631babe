"""cmr-import: other people's recordings (CSV, ROS bags, MCAP files, LCM logs of other types) as our event logs.

`mapping` reads where each signal is in a recording, `inputs` finds the files, `csv_source`, `ros_source` and `sources`
read them, `converting` converts them to messages, and `transcribing` writes these to a log.
"""
