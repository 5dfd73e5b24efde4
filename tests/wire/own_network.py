"""The words that run a command in a network namespace of its own."""

import os

# Without the privilege a user namespace grants it, where user namespaces are allowed.
OWN_NETWORK = ["unshare", "-n"] if os.getuid() == 0 else ["unshare", "-rn"]
