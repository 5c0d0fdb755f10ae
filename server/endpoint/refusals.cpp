// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/refusals.h"

#include <chrono>

namespace cairn {
namespace {

constexpr std::chrono::minutes kInterval{1};
constexpr size_t kMostNamed = 3;  ///< in a sentence

/// Describes a process that is not let in by what is known of it, and no more than that.
std::string why_not(const Strangers::Told& stranger, const std::string& refused) {
  const char* nothing = stranger.has_left
                            ? "gone again before it was let in; whether it has keys is not known"
                            : "no keys of this site were shown";
  const std::string what =
      refused.empty()     ? nothing
      : stranger.has_left ? "gone again before it was let in; refused meanwhile: " + refused
                          : "it has shown no keys that this server accepts; refused meanwhile: " + refused;
  return what + " (" + stranger.says + ")";
}

}  // namespace

void Refusals::came(uint64_t participant, std::string says, MonotonicTime now) {
  strangers_.came(participant, std::move(says), now);
  for (auto& [peer, word] : of_certificates_) word.is_due = true;
}

std::vector<wire::RefusedPeer> Refusals::take(MonotonicTime now) {
  for (Words* words : {&of_certificates_, &of_strangers_})
    std::erase_if(*words, [now](const auto& known) { return now - known.second.heard >= kInterval; });
  told_.clear();
  if (refused_ != nullptr)
    for (wire::RefusedPeer& peer : refused_->take()) note(of_certificates_, std::move(peer), now);
  std::vector<wire::RefusedPeer> strangers;
  for (const Strangers::Told& stranger : strangers_.take(now))
    strangers.push_back({"somebody", why_not(stranger, refused_since(stranger.came))});
  for (wire::RefusedPeer& stranger : strangers) note(of_strangers_, std::move(stranger), now);
  return std::exchange(told_, {});
}

void Refusals::note(Words& words, wire::RefusedPeer peer, MonotonicTime now) {
  const bool is_known = words.contains(peer);
  if (!is_known && words.size() >= kMost) return;  // that there are many is on record then
  Word& word = words[peer];
  word.heard = now;
  if (is_known && !word.is_due && now - word.told < kInterval) return;
  if (!limit_.take(now)) return;
  word.told = now;
  word.is_due = false;
  told_.push_back(std::move(peer));
}

std::string Refusals::refused_since(MonotonicTime then) const {
  std::string all;
  size_t named = 0;
  for (const auto& [peer, word] : of_certificates_) {
    if (word.heard < then) continue;
    if (++named > kMostNamed) return all + ", and more";
    all += (all.empty() ? "" : ", ") + peer.who + ": " + peer.why;
  }
  return all;
}

}  // namespace cairn
