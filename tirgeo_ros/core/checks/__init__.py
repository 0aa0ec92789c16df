"""Check the set-up and the sensors by their own data.

A check takes the data (samples, solutions, poses, frames) and returns, when asked, its findings:
the evidence in numbers, the parameter that is wrong, and how to correct it. The same checks run in
the nodes and in the commands. They reject no data; only the filter does that.
"""
