#pragma once
// Exclusive use of a place on a link.
#include <string>

namespace forceaxis::host {

// An interface, whose frames have no run number, carries one plant and every axis once; a run over
// LCM has one plant an axis. The claim ends with the object, or with the process however that ends;
// one that is just ending is waited for. Throws TransportError naming `where`. Network namespaces
// do not see each other's.
class LinkClaim {
 public:
  LinkClaim(const std::string &where, const std::string &role);
  ~LinkClaim();
  LinkClaim(const LinkClaim &) = delete;
  LinkClaim &operator=(const LinkClaim &) = delete;

  // Whether a process of this machine and network namespace holds the claim; one that is stopped
  // does, one that ended does not.
  static bool held(const std::string &where, const std::string &role);

 private:
  int socket_;
};

}  // namespace forceaxis::host
