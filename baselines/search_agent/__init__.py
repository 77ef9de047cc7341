"""The agent that scores candidate goals drawn from an exact belief: what it sees, how it decides, how it flies."""
