"""What the host does around compiled functions: precision, threads, progress bars. It depends on nothing else."""
