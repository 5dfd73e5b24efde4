"""The words that run a command in a network namespace of its own."""

import os

# A user namespace gives the right to one, where it is not there and allowed.
OWN_NETWORK = ["unshare", "-n"] if os.getuid() == 0 else ["unshare", "-rn"]
