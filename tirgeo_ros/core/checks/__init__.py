"""Find what is wrong with a set-up or a sensor in the data themselves.

A check takes what comes (samples, solutions, poses, frames) and tells, when asked, what it has
found: the evidence in numbers, the parameter that is wrong, and how to mend it. The same checks
run in the nodes and in the commands. They refuse nothing: that is the filter's.
"""
