#pragma once
// Exclusive use of an interface or URL by one plant or axis of a link.
#include <string>

namespace forceaxis::host {

// Claims a role on a link. On a CAN interface, whose frames have no run number, one plant and each
// axis may exist once. A run over LCM may have one plant for each axis. The claim ends with this
// object or with the process, also if the process is killed. The constructor waits for a claim that
// is about to end. Throws TransportError, which names `where`. Processes in different network
// namespaces cannot see each other's claims.
class LinkClaim {
 public:
  LinkClaim(const std::string &where, const std::string &role);
  ~LinkClaim();
  LinkClaim(const LinkClaim &) = delete;
  LinkClaim &operator=(const LinkClaim &) = delete;

  // Returns whether a process of this machine and network namespace has the claim. A process that
  // is suspended still has it.
  static bool held(const std::string &where, const std::string &role);

 private:
  int socket_;
};

}  // namespace forceaxis::host
