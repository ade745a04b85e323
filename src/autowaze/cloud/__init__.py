"""At the service: semantic map diffs in, a true map and the state of every parking spot out."""
