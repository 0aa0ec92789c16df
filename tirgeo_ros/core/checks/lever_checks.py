"""stub"""


class LeverChecks:
    def __init__(self, c, g):
        pass

    def block(self, b):
        pass

    def solution(self, b):
        pass

    def position(self, *b):
        pass

    def findings(self, b):
        return []
