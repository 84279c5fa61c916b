"""Bags of ROS messages (MCAP, ROS 1, ROS 2): their topics, and the frames of a topic of markers."""
