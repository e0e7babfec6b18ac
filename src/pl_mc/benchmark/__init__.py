"""The benchmark: how fast a sweep runs on this machine beside other ways to do the same work, and how exactly."""
