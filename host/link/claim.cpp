#include "host/link/claim.hpp"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstddef>
#include <cstring>
#include <thread>

#include "host/link/transport.hpp"

namespace forceaxis::host {
namespace {

// Number of attempts to lock a role. An axis_node keeps its lock for 0.25 s after a run, because
// axis_node still answers repeated records in this time.
constexpr int kClaimTries = 50;
constexpr std::chrono::milliseconds kClaimWait{10};

// The name of a socket in the abstract namespace. Only one socket in a network namespace can have a
// certain name.
struct Name {
  Name(const std::string &where, const std::string &role) {
    path.sun_family = AF_UNIX;
    const std::string text = "forceaxis-link/" + role + "/" + where;
    text.copy(path.sun_path + 1, sizeof path.sun_path - 2);
    length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 +
                                    std::min(text.size(), sizeof path.sun_path - 2));
  }
  const sockaddr *address() const { return reinterpret_cast<const sockaddr *>(&path); }

  sockaddr_un path{};
  socklen_t length = 0;
};

std::string why(int error) { return std::strerror(error); }

}  // namespace

LinkClaim::LinkClaim(const std::string &where, const std::string &role)
    : socket_(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
  if (socket_ < 0) {
    throw TransportError(where + ": cannot lock the role " + role + ": " + why(errno));
  }
  const Name name(where, role);
  for (int tries = 0; bind(socket_, name.address(), name.length) != 0; ++tries) {
    const int error = errno;
    if (error == EADDRINUSE && tries < kClaimTries) {
      std::this_thread::sleep_for(kClaimWait);
      continue;
    }
    close(socket_);
    if (error != EADDRINUSE) {
      throw TransportError(where + ": cannot lock the role " + role + ": " + why(error));
    }
    throw TransportError(
        where + ": expected to be the only " + role +
        " here, but another run has this role; wait for that run, or choose another interface, run "
        "number or network namespace (tools/vcan)");
  }
}

LinkClaim::~LinkClaim() { close(socket_); }

bool LinkClaim::held(const std::string &where, const std::string &role) {
  const int probe = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (probe < 0) return false;
  const Name name(where, role);
  const bool found = connect(probe, name.address(), name.length) == 0;
  close(probe);
  return found;
}

}  // namespace forceaxis::host
