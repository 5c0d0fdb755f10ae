// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/doorkeeper.h"

namespace cairn {
namespace {

/// Who is revoked is gone within a second.
constexpr std::chrono::milliseconds kLookInterval{250};
/// What goes on trying must not fill the audit log.
constexpr std::chrono::minutes kTellInterval{1};
constexpr size_t kMostRefusedTold = 32;  ///< different ones within that time

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

bool Doorkeeper::is_to_be_told(IdentityRole role, const std::string& name, MonotonicTime now) {
  return told_.try_emplace({role, name}, kTellInterval).first->second.due(now);
}

std::vector<wire::RefusedPeer> Doorkeeper::refused_to_be_told(MonotonicTime now) {
  if (!keys_.is_secured()) return {};
  std::erase_if(refused_told_, [now](const auto& known) { return now - known.second >= kTellInterval; });
  std::vector<wire::RefusedPeer> refused;
  if (refused_ != nullptr) refused = refused_->take();
  for (const Strangers::Told& stranger : strangers_.take(now)) {
    const char* what = stranger.has_left ? "gone again before it was let in; whether it has keys is not known"
                                         : "no keys of this site were shown";
    refused.push_back({"somebody", std::string(what) + " (" + stranger.says + ")"});
  }
  std::vector<wire::RefusedPeer> told;
  for (wire::RefusedPeer& peer : refused) {
    // That there are many is on record then.
    if (refused_told_.size() >= kMostRefusedTold || !refused_told_.try_emplace(peer, now).second) continue;
    told.push_back(std::move(peer));
  }
  return told;
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
