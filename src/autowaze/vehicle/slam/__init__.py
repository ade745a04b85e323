"""Where the car is: tracking, local map, bundle adjustment, relocalisation."""
