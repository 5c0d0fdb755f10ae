// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/doorkeeper.h"

namespace cairn {
namespace {

/// Who is revoked is gone within a second.
constexpr std::chrono::milliseconds kLookInterval{250};

}  // namespace

Principal Doorkeeper::client(std::string name) const {
  return client_principal(std::move(name),
                          keys_.is_secured() ? Principal::Proof::kProven : Principal::Proof::kClaimed);
}

Principal Doorkeeper::operator_of(std::string name) {
  // Where nobody is known, everybody may do all.
  if (!keys_.is_secured())
    return operator_principal(std::move(name), Principal::Proof::kClaimed, Duty::kAdminister);
  auto duty = keys_.duty_of(name);
  if (!duty) {  // its keys may have been made a moment ago
    read();
    duty = keys_.duty_of(name);
  }
  if (!duty && unknown_operator_.due()) {
    log_->warn(
        "operator {} has keys of this site, but {} in this server's security folder does not know it: it may "
        "watch only. Copy the file there from the folder of the keys",
        name, kRegisterFile);
  }
  return operator_principal(std::move(name), Principal::Proof::kProven, duty.value_or(Duty::kWatch));
}

std::optional<std::string> Doorkeeper::note_try(IdentityRole role, const std::string& name,
                                                const std::optional<wire::PeerId>& process,
                                                MonotonicTime now) {
  const auto untold = tries_.note(std::string(to_string(role)) + " " + name, process, now);
  if (!untold) return std::nullopt;
  if (*untold == 0) return kRevoked;
  return std::string(kRevoked) + "; " + std::to_string(*untold) +
         " messages of it were passed over meanwhile";
}

std::vector<wire::RefusedPeer> Doorkeeper::refused_to_be_told(MonotonicTime now) {
  return keys_.is_secured() ? refusals_.take(now) : std::vector<wire::RefusedPeer>();
}

bool Doorkeeper::look(MonotonicTime now) {
  if (now < next_look()) return false;
  next_look_ = now + kLookInterval;
  read();
  return std::exchange(is_changed_, false);
}

void Doorkeeper::read() {
  const auto changed = keys_.look();
  if (changed) {
    is_changed_ |= *changed;
  } else if (trouble_.due()) {
    log_->error("who has keys of this site: {}; what was known before holds", changed.error().message);
  }
}

}  // namespace cairn
