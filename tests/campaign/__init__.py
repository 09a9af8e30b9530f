"""The fault campaign: seeded random trials of everything that can go wrong around the program.

`python -m tests.campaign --seed 1 --minutes 25` tries damaged images, odd folders, hostile model
files, full disks, kills and the like against the real program, each trial in a folder of its own,
and prints a table: per kind, how many trials passed, how many were refused with a sentence, and how
many were faults.  What a fault is stands in `judge`; what is tried stands in the modules of the
kinds, which `kinds` lists.  A trial depends on its kind and number alone: `--only KIND:NUMBER`
repeats it.  Linux only, for what a process holds is read from /proc.
"""
