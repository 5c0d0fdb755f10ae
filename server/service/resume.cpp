// SPDX-License-Identifier: Apache-2.0
#include "server/service/resume.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <tuple>

#include "common/base/enumerators.h"
#include "common/base/utf8.h"
#include "server/store/epochs.h"

namespace cairn {
namespace {

// A file from elsewhere may hold what this server would never have written: a client drops a verdict with a
// number that it does not know or with a reason that it does not take, and would wait for ever.

template <BoundedEnum Enum>
Enum known_or(uint8_t number, Enum otherwise) {
  return is_enumerator<Enum>(number) ? static_cast<Enum>(number) : otherwise;
}

std::string fitting_reason(const DecisionRecord& decision) {
  return std::string(cut_text(one_line(decision.reason), wire::kMaxReasonBytes));
}

wire::OfferOutcome outcome_of(const DecisionRecord& decision, const KeptDecisions& map) {
  wire::OfferOutcome outcome;
  outcome.seq = decision.seq;
  outcome.decision = known_or(decision.decision, wire::OfferDecision::kDamaged);
  outcome.reason = fitting_reason(decision);
  outcome.map = map.map;
  outcome.keyframe = decision.keyframe;
  outcome.epoch = map.epoch;
  outcome.revision = Revision{1};
  return outcome;
}

wire::RequestOutcome request_outcome_of(const DecisionRecord& decision, const KeptDecisions& map) {
  return {decision.seq, known_or(decision.decision, wire::RequestDecision::kUnfit), fitting_reason(decision),
          map.map, LabelId{decision.label}};
}

wire::SeedVerdict verdict_of(const DecisionRecord& decision, const KeptDecisions& map) {
  wire::SeedVerdict verdict;
  verdict.client = client_id_from_name(decision.client);
  verdict.command = {decision.session, decision.seq};
  verdict.accepted = true;
  verdict.map = map.map;
  verdict.epoch = map.epoch;
  verdict.revision = Revision{1};
  verdict.first_keyframe = KeyframeId{1};
  verdict.second_keyframe = decision.keyframe;
  verdict.points = decision.seed_points;
  return verdict;
}

/// An offer that was kept aside and accepted later has two decisions. Ascending by seq.
void keep_last_of_each(std::vector<wire::OfferOutcome>* offers) {
  const auto same = [](const auto& a, const auto& b) { return a.seq == b.seq; };
  std::reverse(offers->begin(), offers->end());
  offers->erase(std::unique(offers->begin(), offers->end(), same), offers->end());
  std::reverse(offers->begin(), offers->end());
}

}  // namespace

std::vector<std::pair<std::string, ResumedClient>> resume_clients(std::span<const KeptDecisions> maps,
                                                                  size_t most) {
  std::map<std::string, std::pair<Timestamp, SessionId>> newest;
  for (const KeptDecisions& map : maps) {
    for (const DecisionRecord& d : map.decisions) {
      auto& [time, session] = newest[d.client];
      if (d.time >= time) std::tie(time, session) = std::pair(d.time, d.session);
    }
  }
  std::map<std::string, ResumedClient> clients;
  for (const auto& [name, entry] : newest) clients[name].session = entry.second;
  for (const KeptDecisions& map : maps) {
    for (const DecisionRecord& d : map.decisions) {
      ResumedClient& client = clients[d.client];
      if (d.session != client.session) continue;
      if (d.kind == CommandKind::kOffer) {
        client.offers.push_back(outcome_of(d, map));
      } else if (d.kind == CommandKind::kRequest) {
        client.requests.push_back(request_outcome_of(d, map));
      } else if (!client.seed || client.seed->command.seq < d.seq) {
        client.seed = verdict_of(d, map);
      }
    }
  }
  for (auto& [name, client] : clients) {
    const auto by_seq = [](const auto& a, const auto& b) { return a.seq < b.seq; };
    std::stable_sort(client.offers.begin(), client.offers.end(), by_seq);
    keep_last_of_each(&client.offers);
    std::sort(client.requests.begin(), client.requests.end(), by_seq);
  }
  std::vector<std::pair<std::string, ResumedClient>> by_use(std::make_move_iterator(clients.begin()),
                                                            std::make_move_iterator(clients.end()));
  const auto used = [&newest](const auto& client) { return newest.at(client.first).first; };
  std::stable_sort(by_use.begin(), by_use.end(),
                   [&](const auto& a, const auto& b) { return used(a) < used(b); });
  if (by_use.size() > most) by_use.erase(by_use.begin(), by_use.end() - static_cast<std::ptrdiff_t>(most));
  return by_use;
}

LabelId last_label_of(std::span<const DecisionRecord> decisions) {
  LabelId last;
  for (const DecisionRecord& d : decisions) {
    if (d.kind == CommandKind::kRequest) last = std::max(last, LabelId{d.label});
  }
  return last;
}

std::string maker_of(std::span<const DecisionRecord> decisions) {
  const auto seed = std::find_if(decisions.begin(), decisions.end(),
                                 [](const DecisionRecord& d) { return d.kind == CommandKind::kSeed; });
  return seed == decisions.end() ? std::string() : seed->client;
}

bool carry_over(std::span<const EpochRecord> epochs, Epoch tracked_in, Epoch present, KeyframeInput* frame) {
  const auto left = ids_in_common(epochs, tracked_in, present);
  if (!left || frame->reference.value > left->keyframes) return false;
  std::erase_if(frame->measurements, [&](const PointMeasurement& m) { return m.id.value > left->points; });
  return true;
}

}  // namespace cairn
