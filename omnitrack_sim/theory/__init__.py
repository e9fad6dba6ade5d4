"""Sections III and IV of the paper: kinematics, and the motion singularity region."""
