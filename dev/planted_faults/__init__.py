"""Faults of set-up and sensors, planted in a good flight, and whether ``tirgeo check`` names them.

``make planted-faults`` prints the table.
"""
