"""The behaviour agent: a rule-based expert on privileged state."""
