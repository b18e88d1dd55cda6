"""What can move: rank, redundancy, exchange of joints, free motions."""
