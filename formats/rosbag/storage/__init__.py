"""The files that bags are kept in: ROS 1, MCAP and SQLite.

`mcap` compares the checksum of a file's summary; those of its chunks are compared only in
`formats.rosbag.storage.salvaged_mcap`, which reads damaged files.
"""
