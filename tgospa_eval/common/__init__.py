"""What every stage uses and none is about: messages, files, progress, numbers as text."""
