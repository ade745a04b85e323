"""Making the bundled segmentation model: data from the simulator, training, export, evaluation."""
