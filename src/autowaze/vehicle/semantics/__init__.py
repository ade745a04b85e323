"""What the car sees: instance segmentation, tracking, features with labels, parked or moving."""
