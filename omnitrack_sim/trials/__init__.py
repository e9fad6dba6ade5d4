"""Many runs: sweeps, studies and benchmarks on one engine."""
