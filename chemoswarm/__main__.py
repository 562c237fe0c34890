"""`python -m chemoswarm`: the command `swarm`."""

from trainers.command import main

if __name__ == "__main__":
    main()
