"""``python -m tgospa_eval`` is ``tgospa-eval``."""

from tgospa_eval.cli import main

if __name__ == "__main__":
    main()
