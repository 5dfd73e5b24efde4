#pragma once
// Locks an interface or URL so that only one process is a certain plant or axis of a link.
#include <string>

namespace forceaxis::host {

// A lock on a role of a link: plant or axis N. On a CAN interface, whose frames have no run number,
// only one process may be the plant and only one process may be axis N. A run over LCM may have one
// plant for each axis. The lock ends with this object or with the process, also if the process is
// killed. The constructor waits for a short time if another process has the lock. If the other
// process keeps the lock, the constructor throws TransportError, which names `where`. Locks have no
// effect between different network namespaces.
class LinkClaim {
 public:
  LinkClaim(const std::string &where, const std::string &role);
  ~LinkClaim();
  LinkClaim(const LinkClaim &) = delete;
  LinkClaim &operator=(const LinkClaim &) = delete;

  // Returns true if a process of this machine and network namespace has the lock. A suspended
  // process keeps its locks.
  static bool held(const std::string &where, const std::string &role);

 private:
  int socket_;
};

}  // namespace forceaxis::host
