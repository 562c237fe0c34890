"""What is possible: the physical limit of the gain, and the policy that attains it."""
