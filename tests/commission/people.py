"""Whoever stands at the water in tests: answers by a script, and what was asked and said."""


class Scripted:
    """Says yes unless a question holds a word of `no`; numbers come in order, then there are none."""

    def __init__(self, numbers=(), no=()):
        self.numbers, self.no = list(numbers), tuple(no)
        self.questions, self.lines = [], []

    def confirm(self, question):
        self.questions.append(question)
        return not any(word in question for word in self.no)

    def number(self, question, unit):
        self.questions.append(f"{question} [{unit}]")
        return self.numbers.pop(0) if self.numbers else None

    def say(self, line):
        self.lines.append(line)

    def progress(self, what, share=None):
        pass
