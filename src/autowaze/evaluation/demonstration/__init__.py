"""The whole loop on simulated streets: surveys, a service, three cars, and how right they were."""
