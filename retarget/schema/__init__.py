"""What people write: YAML files read strictly, as models of a profile, priorities, a performer and a scene."""
