"""The nouns that the car and the cloud share; imports nothing else of ours."""
