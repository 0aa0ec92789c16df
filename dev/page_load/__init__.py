"""Measure the page: ``python -m dev.page_load`` by sockets, ``.in_browser`` with Chromium."""
