"""How fast the engines are: `python -m liftdrag.speed [NAME ...]`, in quiet minutes."""
