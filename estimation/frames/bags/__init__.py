"""Bags of ROS messages (MCAP, ROS 1, ROS 2): their topics, and frames from topics of markers."""
