// SPDX-License-Identifier: Apache-2.0
#include "server/service/operators.h"

#include <exception>
#include <utility>
#include <variant>

#include "common/base/overloaded.h"
#include "server/service/admin_reply.h"

namespace cairn {
namespace {

constexpr const char* kInternal = "internal error; the server's log says more";

}  // namespace

/// A request of an operator, from when it is taken on until it is answered. One whose answer is lost, with an
/// exception or a task that is dropped, is answered with that: its place is given back whatever happens.
class Operators::Ticket {
 public:
  Ticket(AdminAnswer answer, Post post) : answer_(std::move(answer)), post_(std::move(post)) {}
  ~Ticket() {
    if (answer_) post_([answer = std::move(answer_)] { answer(refusal(ErrorCode::kInternal, kInternal)); });
  }
  Ticket(const Ticket&) = delete;
  Ticket& operator=(const Ticket&) = delete;

  void answer(OperatorAnswer told) {
    if (const AdminAnswer once = std::exchange(answer_, nullptr)) once(std::move(told));
  }

 private:
  AdminAnswer answer_;
  const Post post_;
};

void Operators::take(const Principal& who, const wire::AdminRequest& message) {
  const std::string& operator_name = who.name;
  const auto tell = [this, operator_name, command = message.command](const OperatorAnswer& told) {
    wire::AdminReply reply = reply_of(told);
    reply.operator_id = client_id_from_name(operator_name);
    reply.command = command;
    if (reply.result != 0) context_.log->info("operator {}: refused: {}", operator_name, reply.text);
    const wire::CommandId answered = reply.command;
    gate_.answered(operator_name, std::move(reply), context_.now());
    repeat_answer(operator_name, answered);
  };
  const AdminGate::Judgement judged = gate_.admit(operator_name, message.command, context_.now());
  switch (judged.admission) {
    case AdminGate::Admission::kNew:
      break;
    case AdminGate::Admission::kInWork:
      return;
    case AdminGate::Admission::kRepeated:
      return repeat_answer(operator_name, message.command);
    case AdminGate::Admission::kRefused:
      return refuse_for_now(operator_name, message.command, judged.why);
  }
  const AdminAnswer answer = [ticket = std::make_shared<Ticket>(tell, context_.post)](OperatorAnswer told) {
    ticket->answer(std::move(told));
  };
  try {
    carry_out(who, message, answer);
  } catch (const std::exception& problem) {
    context_.log->error("internal error in a request of operator {}: {}", operator_name, problem.what());
    answer(refusal(ErrorCode::kInternal, kInternal));
  }
}

/// Refuses a request that may be asked again later. That is not logged: there may be many.
void Operators::refuse_for_now(const std::string& operator_name, wire::CommandId command,
                               const std::string& why) {
  wire::AdminReply reply = reply_of(refusal(ErrorCode::kRefused, why));
  reply.operator_id = client_id_from_name(operator_name);
  reply.command = command;
  gate_.answered(operator_name, std::move(reply), context_.now());
  repeat_answer(operator_name, command);
}

void Operators::repeat_answer(const std::string& operator_name, wire::CommandId command) {
  const wire::AdminReply* reply = gate_.last({operator_name, command.session});
  if (reply == nullptr) return;
  const Status written = context_.output.answer(operator_name, *reply);
  if (!written && output_trouble_.due(context_.now()))
    context_.log->error("operator {} cannot be answered: {}", operator_name, written.error().message);
}

void Operators::carry_out(const Principal& who, const wire::AdminRequest& message, const AdminAnswer& tell) {
  const Result<AskedOfServer> asks = read_admin_request(message.request);
  if (!asks) return tell(refusal(asks.error()));
  const AdminAnswer answer = asks->is_audited() ? desks_.site.audited(who.name, *asks, tell) : tell;
  context_.log->log(asks->is_piece ? spdlog::level::debug : spdlog::level::info, "operator {}: {}", who.name,
                    asks->text);
  if (const Status may = context_.access().may_ask(who, asks->act); !may) return answer(refusal(may.error()));
  pass_on(who, *asks, message.data, answer);
}

void Operators::pass_on(const Principal& who, const AskedOfServer& asks, const std::vector<uint8_t>& data,
                        const AdminAnswer& answer) {
  const auto of_store = [&](const auto& ask) { desks_.store.take(who.name, ask, answer); };
  const auto of_proposals = [&](const auto& ask) { desks_.proposals.take(ask, answer); };
  const Overloaded cases{
      [&](const asked::Unknown&) {
        answer(refusal(ErrorCode::kUsage, "this server does not know '" + asks.verb + "'"));
      },
      [&](const asked::Unfit& unfit) { answer(refusal(unfit.why)); },
      [&](const asked::Status&) { answer(desks_.overview.server()); },
      [&](const asked::Rigs&) { answer(told::Rigs{desks_.rigs.seen(context_.now())}); },
      [&](const asked::Clients&) { answer(desks_.overview.clients()); },
      [&](const asked::KickClient& ask) { kick(ask.client, answer); },
      [&](const asked::Maps& ask) { desks_.overview.list(ask, answer); },
      [&](const asked::ChangeRights& ask) { desks_.site.take(who.name, ask, answer); },
      [&](const asked::Rights& ask) { desks_.site.take(ask, answer); },
      [&](const asked::ExplainRights& ask) { desks_.site.take(ask, answer); },
      [&](const asked::Audit& ask) { desks_.site.take(ask, answer); },
      [&](const asked::Undelete& ask) { desks_.maps.undelete(ask.map, answer); },
      [&](const asked::Purge& ask) { desks_.maps.purge(ask.map, answer); },
      [&](const asked::Import& ask) { desks_.archives.import_map(ask, answer); },
      [&](const asked::ImportBegin& ask) { desks_.archives.begin_import(ask, answer); },
      [&](const asked::ImportWrite& ask) { desks_.archives.write(ask, data, answer); },
      [&](const asked::ExportRead& ask) { desks_.archives.read(ask, answer); },
      [&](const asked::Backup& ask) { of_store(ask); },
      [&](const asked::BackupPart& ask) { of_store(ask); },
      [&](const asked::Verify& ask) { desks_.store.take(ask, answer); },
      [&](const asked::VerifyPart& ask) { desks_.store.take(ask, answer); },
      [&](const asked::Proposals& ask) {
        const bool is_known = ask.map.empty() || find_called(maps_, ask.map).second != nullptr;
        if (!is_known) return desks_.maps.answer_without_map(asks.verb, ask.map, answer);
        of_proposals(ask);
      },
      [&](const asked::ShowProposal& ask) { of_proposals(ask); },
      [&](const asked::ProposalImage& ask) { of_proposals(ask); },
      [&](const asked::AcceptProposal& ask) { of_proposals(ask); },
      [&](const asked::DropProposal& ask) { of_proposals(ask); },
      [&](const asked::OfMap& ask) { pass_on(who, asks.verb, ask, answer); }};
  std::visit(cases, asks.what);
}

void Operators::pass_on(const Principal& who, const std::string& verb, const asked::OfMap& ask,
                        const AdminAnswer& answer) {
  const auto [id, entry] = find_called(maps_, ask.map);
  if (entry == nullptr) return desks_.maps.answer_without_map(verb, ask.map, answer);
  const Overloaded cases{
      [&, id = id, entry = entry](const asked::Show&) { desks_.overview.show(id, *entry, answer); },
      [&, id = id, entry = entry](const asked::Rename& what) {
        desks_.maps.rename(id, entry, what.name, answer);
      },
      [&, id = id, entry = entry](const asked::Delete& what) {
        desks_.maps.remove(id, entry, what.for_good, answer);
      },
      [&, id = id, entry = entry](const asked::Export&) { desks_.archives.export_map(id, *entry, answer); },
      [&, id = id, entry = entry](const asked::OfVersions& what) {
        desks_.versions.take(who.name, id, entry, what, answer);
      },
      [&, id = id, entry = entry](const auto& what) { desks_.labels.take(who, id, *entry, what, answer); }};
  std::visit(cases, ask.what);
}

void Operators::kick(const std::string& client, const AdminAnswer& answer) {
  const Status kicked = desks_.sessions.kick(client);
  if (!kicked) return answer(refusal(kicked.error()));
  answer(told::Done{"client " + client + " is not served until it is started again"});
}

}  // namespace cairn
