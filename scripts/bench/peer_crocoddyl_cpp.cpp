// crocoddyl's C++ solvers, risk-neutral, one thread, on the scenes of bench/scene_cases.hpp (phri_control): its action
// models call our plants' and costs' own functions, so it is the same problem with the same exact derivatives. Speaks
// the protocol of peer.py. Started by peer_crocoddyl_cpp.py, which compiles it against the wheel.
//   peer_crocoddyl_cpp CASE   what bench_scenes --write_case wrote
// A solve starts from zero controls rolled out (timed, as ours) and takes the faster of SolverDDP and SolverFDDP among
// those that end at our cost. Building models and data is not timed.
#include <crocoddyl/config.hh>
#include <crocoddyl/core/actions/lqr.hpp>
#include <crocoddyl/core/solvers/ddp.hpp>
#include <crocoddyl/core/solvers/fddp.hpp>
#include <ctime>
#include <fstream>
#include <functional>
#include <iostream>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "scene_cases.hpp"

namespace
{
using namespace phri_control;
using nlohmann::json;
using phri_control_bench::SceneCase;
using Action = crocoddyl::ActionModelAbstractTpl<double>;
using ActionData = crocoddyl::ActionDataAbstractTpl<double>;
using Shooting = crocoddyl::ShootingProblemTpl<double>;

constexpr double kSame = 1e-9;  // as rows.py: relative difference of the costs
constexpr int kMaxIterations = 100;

template <int N>
class Node : public Action
{
public:
  CROCODDYL_BASE_DERIVED_CAST(crocoddyl::ActionModelBase, Node)
  using VectorXs = Eigen::VectorXd;
  using Point = Eigen::Ref<const VectorXs>;

  struct Data : ActionData
  {
    explicit Data(Node* model) : ActionData(model), next(Eigen::Matrix<double, N, 1>::Zero()) {}
    Eigen::Matrix<double, N, 1> next;
    Eigen::Matrix<double, N, N> A;
    Eigen::Matrix<double, N, 2> B;
    CostExpansion<N, 2> cost_expansion = CostExpansion<N, 2>::zero();
    LqTerminal<N> end = LqTerminal<N>::zero();
  };

  Node(const OptimalControlProblem<N, 2>& problem, int k)
    : Action(std::make_shared<crocoddyl::StateVectorTpl<double>>(N), 2), problem_(problem), k_(k)
  {
  }
  void calc(const std::shared_ptr<ActionData>& data, const Point& x, const Point& u) override
  {
    Data& own = static_cast<Data&>(*data);
    problem_.dynamics->step(k_, x, u, own.next);
    own.xnext = own.next;
    own.cost = problem_.cost->running(k_, x, u);
  }
  void calc(const std::shared_ptr<ActionData>& data, const Point& x) override
  {
    data->cost = problem_.cost->terminal(x);
  }
  void calcDiff(const std::shared_ptr<ActionData>& data, const Point& x, const Point& u) override
  {
    Data& own = static_cast<Data&>(*data);
    problem_.dynamics->linearise(k_, x, u, own.A, own.B);
    problem_.cost->expand(k_, x, u, own.cost_expansion);
    own.Fx = own.A;
    own.Fu = own.B;
    own.Lx = own.cost_expansion.q;
    own.Lu = own.cost_expansion.r;
    own.Lxx = own.cost_expansion.Q;
    own.Luu = own.cost_expansion.R;
    if (own.cost_expansion.has_cross)
      own.Lxu = own.cost_expansion.S.transpose();
  }
  void calcDiff(const std::shared_ptr<ActionData>& data, const Point& x) override
  {
    Data& own = static_cast<Data&>(*data);
    problem_.cost->expandTerminal(x, own.end);
    own.Lx = own.end.q;
    own.Lxx = own.end.Q;
  }
  std::shared_ptr<ActionData> createData() override
  {
    return std::allocate_shared<Data>(Eigen::aligned_allocator<Data>(), this);
  }

private:
  OptimalControlProblem<N, 2> problem_;
  int k_;
};

/// Mean CPU time of this thread per call [us], over at least `seconds`, as peer.py's mean_time.
double meanTime(const std::function<void()>& call, double seconds)
{
  const auto now = [] {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
  };
  call();
  long calls = 0, batch = 1;
  const double start = now();
  double elapsed = 0.0;
  for (; elapsed < seconds || calls == 0; elapsed = now() - start)
  {
    for (long i = 0; i < batch; ++i)
      call();
    calls += batch;
    batch = std::min(2 * batch, 1000L);
  }
  return 1e6 * elapsed / double(calls);
}

/// Largest difference over the largest element of ours; crocoddyl's u = -K x.
double gainDifference(const crocoddyl::SolverDDP& solver, const json& gains)
{
  double largest = 0.0, difference = 0.0;
  std::size_t next = 0;
  for (const auto& K : solver.get_K())
    for (Eigen::Index i = 0; i < K.rows(); ++i)
      for (Eigen::Index j = 0; j < K.cols(); ++j)
      {
        const double ours = gains.at(next++).get<double>();
        largest = std::max(largest, std::abs(ours));
        difference = std::max(difference, std::abs(-K(i, j) - ours));
      }
  return next == gains.size() ? difference / largest : std::numeric_limits<double>::infinity();
}

std::vector<Eigen::VectorXd> points(const json& flat, Eigen::Index size)
{
  std::vector<Eigen::VectorXd> out(flat.size() / size, Eigen::VectorXd(size));
  for (std::size_t k = 0; k < out.size(); ++k)
    for (Eigen::Index i = 0; i < size; ++i)
      out[k](i) = flat.at(k * size + i).get<double>();
  return out;
}

struct Peer
{
  json checks;
  std::vector<std::function<void(double seconds, json& answer)>> measure;

  /// One backward pass with the derivatives of `states`, `controls`, unregularised: [ns] per stage.
  void addBackward(const std::string& name, const std::shared_ptr<Shooting>& shooting,
                   const std::vector<Eigen::VectorXd>& states, const std::vector<Eigen::VectorXd>& controls,
                   const json& gains)
  {
    const auto solver = std::make_shared<crocoddyl::SolverDDP>(shooting);
    solver->setCandidate(states, controls, true);
    shooting->calc(states, controls);
    solver->set_preg(0.0);
    solver->computeDirection(true);
    checks[name + "_stage"] = gainDifference(*solver, gains);
    measure.push_back([=](double seconds, json& answer) {
      shooting->calc(states, controls);  // the solves of the scene share the data
      solver->computeDirection(true);
      const double stage =
          1e3 * meanTime([&] { solver->backwardPass(); }, seconds) / static_cast<double>(controls.size());
      answer[name + "_stage"] = answer[name + "_risk_stage"] = stage;
    });
  }

  template <int N>
  void addScene(const SceneCase<N>& scene, const json& ours)
  {
    std::vector<std::shared_ptr<Action>> nodes;
    for (int k = 0; k < scene.problem.horizon; ++k)
      nodes.push_back(std::make_shared<Node<N>>(scene.problem, k));
    const auto shooting =
        std::make_shared<Shooting>(scene.start, nodes, std::make_shared<Node<N>>(scene.problem, scene.problem.horizon));
    shooting->set_nthreads(1);
    addBackward(scene.name, shooting, points(ours.at("states"), N), points(ours.at("controls"), 2), ours.at("gains"));

    const std::vector<Eigen::VectorXd> zero(nodes.size(), Eigen::VectorXd::Zero(2));
    std::vector<Eigen::VectorXd> states(nodes.size() + 1, Eigen::VectorXd::Zero(N));
    std::vector<std::shared_ptr<crocoddyl::SolverDDP>> same;
    double nearest = std::numeric_limits<double>::infinity();
    const double cost = ours.at("cost").get<double>();
    for (const std::shared_ptr<crocoddyl::SolverDDP>& solver :
         { std::make_shared<crocoddyl::SolverDDP>(shooting),
           std::shared_ptr<crocoddyl::SolverDDP>(std::make_shared<crocoddyl::SolverFDDP>(shooting)) })
    {
      shooting->rollout(zero, states);
      solver->solve(states, zero, kMaxIterations, true);
      const double difference = std::abs(solver->get_cost() - cost) / std::abs(cost);
      std::cerr << scene.name << ": " << solver->get_iter() + 1 << " iterations, cost differs by " << difference
                << '\n';
      nearest = std::min(nearest, difference);
      if (difference <= kSame)
        same.push_back(solver);
    }
    checks[scene.name + "_solve"] = checks[scene.name + "_iteration"] = nearest;
    measure.push_back([=](double seconds, json& answer) mutable {
      double best = std::numeric_limits<double>::infinity(), iteration = best;
      for (const auto& solver : same)
      {
        const double time = meanTime(
            [&] {
              shooting->rollout(zero, states);
              solver->solve(states, zero, kMaxIterations, true);
            },
            seconds);
        if (time < best)
        {
          best = time;
          iteration = time / static_cast<double>(solver->get_iter() + 1);  // counted from 0
        }
      }
      if (same.empty())
        return;
      answer[scene.name + "_iteration"] = iteration;
      for (const char* row : { "_solve", "_ileqr", "_ikccr" })
        answer[scene.name + row] = best;
    });
  }

  void addMassDamper(const json& ours)
  {
    const LinearQuadraticProblem<4, 2> problem = phri_control_bench::massDamper(200, 0);
    const auto node = [&](const auto& stage, const Eigen::Matrix4d& Q, const Eigen::Vector4d& q) {
      return std::make_shared<crocoddyl::ActionModelLQRTpl<double>>(stage.A, stage.B, Q, stage.R,
                                                                    Eigen::MatrixXd::Zero(4, 2), stage.d, q, stage.r);
    };
    std::vector<std::shared_ptr<Action>> nodes;
    for (const auto& stage : problem.stages)
      nodes.push_back(node(stage, stage.Q, stage.q));
    const auto shooting = std::make_shared<Shooting>(
        Eigen::VectorXd::Zero(4), nodes, node(problem.stages.back(), problem.terminal.Q, problem.terminal.q));
    shooting->set_nthreads(1);
    addBackward("mass_damper", shooting, std::vector<Eigen::VectorXd>(nodes.size() + 1, Eigen::VectorXd::Zero(4)),
                std::vector<Eigen::VectorXd>(nodes.size(), Eigen::VectorXd::Zero(2)), ours.at("gains"));
  }
};
}  // namespace

int main(int argc, char** argv)
{
  if (argc != 2)
  {
    std::cerr << "usage: peer_crocoddyl_cpp CASE\n";
    return 64;
  }
  try
  {
    const json ours = json::parse(std::ifstream(argv[1]));
    Peer peer;
    phri_control_bench::forEachScene([&](const auto& scene) { peer.addScene(scene, ours.at(scene.name)); });
    peer.addMassDamper(ours.at("mass_damper"));
    std::cout << json{ { "version", std::string("crocoddyl ") + CROCODDYL_VERSION + " C++" },
                       { "checks", peer.checks } }
              << std::endl;
    for (std::string line; std::getline(std::cin, line);)
    {
      json answer = json::object();
      const double seconds = json::parse(line).at("seconds").get<double>();
      for (const auto& measure : peer.measure)
        measure(seconds, answer);
      std::cout << answer << std::endl;
    }
  }
  catch (const std::exception& error)
  {
    std::cerr << error.what() << '\n';
    return 70;
  }
}
