"""Which values of a hazard's parameters make an agent fail, and a proof that each hazard can be passed."""
