// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/map/extent.h"
#include "common/map/ids.h"

namespace cairn {

/// Memory [bytes] of the images of all offers that wait, of all clients.
using WaitingBytes = std::shared_ptr<std::atomic<size_t>>;

/// Something that a client has offered and nobody has decided yet; held by what waits for that.
class PendingOffer {
 public:
  PendingOffer(size_t bytes, WaitingBytes all) : bytes_(bytes), all_(std::move(all)) { *all_ += bytes_; }
  ~PendingOffer() { *all_ -= bytes_; }
  PendingOffer(const PendingOffer&) = delete;
  PendingOffer& operator=(const PendingOffer&) = delete;

  void withdraw() { withdrawn_ = true; }
  /// Whether it was withdrawn: its client may not offer it any more. Thread-safe.
  [[nodiscard]] bool is_withdrawn() const { return withdrawn_; }

 private:
  const size_t bytes_;
  const WaitingBytes all_;
  std::atomic<bool> withdrawn_{false};
};

/// The pending offers of one client. What it may do can change before they are decided: then they are
/// withdrawn. Used from one thread.
class PendingOffers {
 public:
  enum class Kind : uint8_t { kSeed, kKeyframe, kProposal };
  struct What {
    Kind kind = Kind::kKeyframe;
    MapId map;                     ///< to which it was offered, or that would come of it
    std::optional<Extent> extent;  ///< within which it was allowed
  };
  [[nodiscard]] std::shared_ptr<const PendingOffer> add(What what, size_t bytes, const WaitingBytes& all) {
    std::erase_if(offers_, [](const Offer& offer) { return offer.waiting.expired(); });
    auto offer = std::make_shared<PendingOffer>(bytes, all);
    offers_.push_back({std::move(what), offer});
    return offer;
  }
  /// Withdraws offers for which `is_over` is true.
  template <typename IsOver>
  void withdraw(const IsOver& is_over) {
    for (const Offer& offer : offers_) {
      const auto waiting = offer.waiting.lock();
      if (waiting && is_over(offer.what)) waiting->withdraw();
    }
  }

 private:
  struct Offer {
    What what;
    std::weak_ptr<PendingOffer> waiting;
  };
  std::vector<Offer> offers_;  ///< few: a client has a credit
};

}  // namespace cairn
