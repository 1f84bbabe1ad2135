"""Pictures of runs, one file a scene."""
