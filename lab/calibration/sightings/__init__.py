"""What is seen of an arm: points, poses, and places that nobody knows (anchors, sockets, planes)."""
