"""On the car: stereo frames in, poses and semantic map diffs out."""
