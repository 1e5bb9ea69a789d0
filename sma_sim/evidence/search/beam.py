"""The search: sets of components, level by level, each level the best few of the one before with one component more."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from math import inf

import numpy as np

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.problem import residuals_at
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.model_changes import without_effect
from sma_sim.evidence.model_selection.nominal_fit import report_model
from sma_sim.evidence.model_selection.score_tests import ScoreTests, ScreeningResult
from sma_sim.evidence.model_selection.sketches import may_reach
from sma_sim.evidence.search import propose
from sma_sim.evidence.search.components import Catalogue, Component, catalogue_for
from sma_sim.evidence.search.refine import (
    SAME_VALLEY,
    SKETCHED,
    TIE,
    WINDOW,
    Model,
    better,
    extended,
    from_priors,
    further_fits,
    in_other_kinetics,
    model_of,
    settled,
    without,
    without_difference,
)
from sma_sim.model.arrays import Matrix
from sma_sim.model.config import MODELS

MAX_COMPONENTS = 3  # of a model: it bounds the time of a search, and recordings of few runs seldom tell more
PARENTS = 3  # models of a level that are extended
EQUATIONS_AFTER = 2  # components: what listed effects explain, one or two of them, may be a single law that no list has
IMITATED = 1000.0  # nats that an effect explains: to leave nothing of more, another law has to be alike to a few per cent
EXCHANGE_SHARE = 0.5  # of what that promises which they would replace: to first order neither is exact
DIFFERENCES = 2  # between recordings that are fitted beside a model, without a sketch: their promises are nearly exact
FORMS = 3  # of the laws of a model that are fitted
ROUNDS = 3  # of exchanges, each from where the last has led


@dataclass(frozen=True)
class Extension:
    """The cost of a model when it was extended, which components were sketched, and the score tests of all effects."""

    cost: float
    tried: frozenset[str]
    tested: tuple[ScreeningResult, ...]


@dataclass
class Book:
    """All models that were fitted, each in its best valley; `kinetics`: whether both are tried; `extended`: those
    that were extended."""

    catalogue: Catalogue
    kinetics: bool
    models: dict[tuple[frozenset[str], str], Model] = field(default_factory=dict)
    extended: dict[tuple[frozenset[str], str], Extension] = field(default_factory=dict)
    _tests: tuple[FitResult, ScoreTests] | None = None

    def tests_of(self, fit: FitResult, context: SearchContext) -> ScoreTests:
        """The score tests beside a fit; the last are kept, since what stands in place of an effect is followed by what its
        model lacks."""
        if self._tests is None or self._tests[0] is not fit:
            self._tests = None  # first: responses take much memory
            self._tests = fit, ScoreTests(fit.problem, fit.z, context.pool)
        return self._tests[1]

    def add(self, models: Iterable[Model | None]) -> list[Model]:
        """Keep models, of two fits of one the better; those as they stand now."""
        found = []
        for model in models:
            if model is not None:
                self.models[model.key] = better(model, self.models.get(model.key))
                found.append(self.models[model.key])
        return found

    def replace(self, model: Model, other: Model | None) -> None:
        """Another fit in place of a model; None: none, there is no such model. The nominal ones stay."""
        if other is not None:
            self.models[model.key] = other
        elif model.components:
            del self.models[model.key]

    @property
    def overdispersion(self) -> float:
        """What the best model so far leaves: no other model leaves less."""
        return min(model.evidence.overdispersion for model in self.models.values())

    @property
    def best(self) -> Model:
        """The best of all models."""
        return self.ranked()[0]

    def find(self, names: frozenset[str]) -> Model | None:
        """The better of the models with these components."""
        return next((model for model in self.ranked(len(names)) if model.names == names), None)

    def with_one_less(self, model: Model, kinetics: str) -> Model | None:
        """The model without the last component of another, with these kinetics; None where there is none."""
        return self.models.get((frozenset(one.name for one in model.components[:-1]), kinetics))

    def beside(self, parent: Model) -> list[Model]:
        """The models with a component more than one, which is their last, and the same kinetics; the best first."""
        found = [one for one in self.ranked(len(parent.components) + 1) if parent.names < one.names]
        return [
            replace(one, components=tuple(sorted(one.components, key=lambda part: part.name not in parent.names)))
            for one in found
            if one.key[1] == parent.key[1]
        ]

    def explains(self, models: Sequence[Model]) -> bool:
        """Whether one of some models leaves nothing, with either of the kinetics."""
        names = {model.names for model in models}
        return any(model.leaves_nothing for model in self.models.values() if model.names in names)

    def reach(self, size: int | None = None) -> float:
        """The cost from which on a model has no weight beside those that there are, or those of a number of components."""
        k = self.overdispersion
        return min((model.reach(k) for model in self.ranked(size)), default=inf)

    def ranked(self, size: int | None = None) -> list[Model]:
        """Models by score, the best first; of a number of components, if one is given."""
        k = self.overdispersion
        chosen = [model for model in self.models.values() if size is None or len(model.components) == size]
        return sorted(chosen, key=lambda model: -model.score(k))


def search(nominal: Sequence[FitResult], context: SearchContext, equations: bool = True, most: int = MAX_COMPONENTS) -> Book:
    """The models that explain the recordings, from the nominal one with each of the kinetics to try.

    Listed effects and differences between recordings first; then, where these leave something, terms of equations. A first
    pass goes on from level to level with what score tests promise, as long as far more is left than another valley could
    explain; what takes longer (`deepen`) follows where that leaves something. `most`: components of a model.
    """
    book = Book(catalogue_for(nominal[0], context), len(nominal) > 1)
    book.add(model_of((), [fit], context) for fit in nominal)
    for size in range(1, min(most, EQUATIONS_AFTER) + 1):
        expand_level(size, book, context, thorough=False)
        improve_forms(size, book, context)
        if book.best.evidence.unlisted < IMITATED:
            break
    for size in range(1, most + 1):
        before = book.best
        expand_level(size, book, context)
        improve(size, book, context)
        if len(book.best.of_robot) == size > 1 and book.best.leaves_nothing and may_be_imitated(book.best, book):
            add_stepped(bare(book), book, context, book.reach())
            improve_without(book.best, book, context)
        if equations and size == EQUATIONS_AFTER and may_be_unlisted(book):
            add_equations(bare(book), book, context)
        if context.stop.is_set() or (book.best is before and len(book.best.components) < size >= EQUATIONS_AFTER):
            break
        if book.best.leaves_nothing and len(book.best.components) < size:
            break
    best = book.best
    if equations and best.components and best.lacks_unlisted and not any(one.is_formula for one in best.components):
        add_equations(best, book, context)
    add_in_kinetics_of_best(book, context)
    exchange_at_ports(book, context)
    fit_rivals(book, context)
    settle(book, context)
    fit_without(book, context)
    leave_out_copies(book, context)
    settle(book, context)
    return book


def may_be_unlisted(book: Book) -> bool:
    """Whether something that no list has may be behind the best model: where something is left, and where
    its effects may imitate another law."""
    return book.best.lacks_unlisted or may_be_imitated(book.best, book)


def may_be_imitated(model: Model, book: Book) -> bool:
    """Whether another law may do to within the noise what some effects of a model do together: where one of these explains
    so little beside the others that it may only mend where they differ from that law. None of nothing."""
    k, rest = book.overdispersion, [book.find(model.names - {one.name}) for one in model.of_robot]
    return any(one is None or model.score(k) - one.score(k) < IMITATED for one in rest)


def leave_out_copies(book: Book, context: SearchContext) -> None:
    """Take equations out of the book that predict what listed effects do, no more of these than components of theirs, to
    within what is called a tie: they are these, written as an equation, and tell of nothing that no list has. More effects
    that imitate one law are no other words for it; the score decides."""
    k = book.overdispersion
    near = [model for model in book.ranked() if model.score(k) >= book.best.score(k) - WINDOW]
    equations = [model for model in near if any(one.is_formula for one in model.components)]
    listed = [model for model in near if model.components and not any(one.is_formula for one in model.components)]
    if not (equations and listed) or context.stop.is_set():
        return
    shown = [(len(one.components), residuals_at(one.fit.problem, one.fit.z, context.pool)) for one in listed]
    for model in equations:
        own, alike = residuals_at(model.fit.problem, model.fit.z, context.pool), 2.0 * TIE * k**2
        if any(size <= len(model.components) and distance(own, other) <= alike for size, other in shown):
            book.replace(model, None)


def distance(some: Sequence[Matrix | None], others: Sequence[Matrix | None]) -> float:
    """The squares, over the noise, by which the predictions of two models differ; inf where one cannot be run."""
    pairs = list(zip(some, others, strict=True))
    return sum(inf if one is None or other is None else float(np.sum((one - other) ** 2)) for one, other in pairs)


def expand_level(size: int, book: Book, context: SearchContext, thorough: bool = True) -> None:
    """Models of a size: extend those with one component less that have weight, as they do once others were extended, until
    the best of all leaves nothing: what other parents lead to has few nats to win then; exchanges look for it."""
    done = set[tuple[frozenset[str], str]]()
    while not (context.stop.is_set() or (book.best.leaves_nothing and len(book.best.components) >= size)):
        parent = next((one for one in parents(book, size - 1) if one.key not in done), None)
        if parent is None:
            return
        is_other = any(names == parent.names for names, _ in done)
        done.add(parent.key)
        if not is_other:
            expand(parent, book, context)
            if thorough:
                deepen(parent, book, context)
        elif thorough:
            expand_in_other_kinetics(parent, book, context)


def exchange_at_ports(book: Book, context: SearchContext) -> None:
    """Models with another effect at its port in place of each of the listed effects of the best one, which has several, as
    long as that leads further: what acts at the same place may do the same, however large, where no first order holds. With
    a single effect, all others have been tried beside what the model without it leaves."""
    done = set[frozenset[str]]()
    for _ in range(ROUNDS):
        best = book.best
        laws = [one for one in best.of_robot if not one.is_formula and best.names - {one.name} not in done]
        for law in laws if len(best.of_robot) > 1 and not context.stop.is_set() else ():
            done.add(best.names - {law.name})
            context.on_progress(f'what may stand in place of {law.name} at its port')
            add_extended(stripped(best, (law,)), propose.at_port_of(law, book.catalogue, best), book, context)
        if book.best is best:
            return


def fit_rivals(book: Book, context: SearchContext) -> None:
    """Fit what comes near the best model, with one effect in place of another, from the middle of all priors too, unless
    it was: else it is where fits began that decides between them."""
    best, k = book.best, book.overdispersion
    for model in book.ranked(len(best.components)):
        parent, effect = book.with_one_less(model, model.key[1]), bool(model.components and model.components[-1].effect)
        if model is best or parent is None or not effect or model.starts > 1 or context.stop.is_set():
            continue
        if len(best.names - model.names) == 1 and model.fit.cost < best.reach(k):
            context.on_progress(f'fitting {words(model)} from the middle of all priors')
            book.add([from_priors(parent.fit, model, best.reach(k), context)])


def settle(book: Book, context: SearchContext) -> None:
    """Fit the models that have weight where they are best under the overdispersion: until then all were fitted without, and
    not all to the end. Where that has led far, fits of models with one component less were as far from theirs: these are
    made again from there, so that none wins by having gone on."""
    k, done = book.overdispersion, list[Model]()
    while not context.stop.is_set():
        ranked = book.ranked()
        near = (one for one in ranked if one.score(k) >= ranked[0].score(k) - WINDOW)
        model = next((one for one in near if not one.is_settled and all(one is not other for other in done)), None)
        if model is None:
            return
        found = settled(model, k, context)
        book.replace(model, found)
        done.append(model if found is None else found)
        if found is not None and model.fit.cost - found.fit.cost > WINDOW * k**2:
            context.on_progress(f'fitting what {words(found)} is made of from where it has led')
            book.add(without(found, one, context) for one in found.components if not one.is_difference)


def fit_without(book: Book, context: SearchContext) -> None:
    """Fit the models with one effect less than the best one from where it lies, where that one explains little: else it may
    be where their fits have ended that decides."""
    best, k = book.best, book.overdispersion
    for one in best.of_robot:
        rest = book.find(best.names - {one.name})
        if (rest is None or best.score(k) - rest.score(k) < IMITATED) and not context.stop.is_set():
            context.on_progress(f'fitting {words(best)} without {one.name}')
            book.add([without(best, one, context)])


def bare(book: Book) -> Model:
    """The nominal model with the kinetics of the best one and what differs between its recordings, as it was fitted: its
    residuals are small enough there for first order to hold, which they need not be where the parameters of the best one
    lie without its effects."""
    kinetics, differing = book.best.key[1], frozenset(one.name for one in book.best.components if one.is_difference)
    return book.models.get((differing, kinetics), book.models[frozenset(), kinetics])


def stripped(model: Model, replaced: Sequence[Component]) -> Model:
    """A model without some of its effects, its parameters where they lie with them: nearer to the true ones than where the
    rest was fitted alone, which bends them to imitate what it lacks."""
    fit = model.fit
    for component in replaced:
        fit = FitResult(*without_effect(fit, component.effect), inf)
    names = {component.name for component in replaced}
    return replace(model, components=tuple(one for one in model.components if one.name not in names), fit=fit)


def add_equations(base: Model, book: Book, context: SearchContext) -> None:
    """Terms of an equation beside the components of a model; then others in place of the best of them, proposed where that
    has led, as long as they explain more; then a second one at its place where the best model lacks something; then listed
    effects in place of what was found: an equation may have led to where one of them lies. In place of listed effects that
    leave nothing, those are fitted that promise a part of what these do; one that leaves nothing but is less probable than
    these may imitate another law, as they may, and leads to where that is proposed."""
    leads, lead = list[Model](), None
    replaced = [one for one in book.best.components if one.effect and one.name not in base.names]
    in_place = bool(replaced) and book.best.leaves_nothing
    timed = not in_place or any(one.uses_time for one in replaced)
    for _ in range(1 + ROUNDS):
        if context.stop.is_set():
            return
        beside = f'beside {words(base)}' if lead is None else f'in place of {lead.components[-1].name}'
        context.on_progress(f'fitting the terms of an equation at every port {beside}')
        least = EXCHANGE_SHARE * propose.promise_of(replaced, base.fit, context) if in_place else -inf
        proposals = [one for one in propose.terms(base.fit, context, timed) if one.promise >= least]
        found = add_extended(base, [one.component for one in proposals], book, context)
        if lead is None:
            fit_again(base, found, book, context)
        leads += found
        before, lead = lead, best_of(leads, book)
        if lead is None or (lead.leaves_nothing and lead is book.best) or (before and lead.names == before.names):
            break
        base = stripped(lead, lead.components[-1:])
    if lead is not None and not lead.leaves_nothing and book.best.lacks_unlisted and not context.stop.is_set():
        second = propose.terms(lead.fit, context, first=lead.components[-1])
        fit_again(lead, add_extended(lead, [one.component for one in second], book, context), book, context)
    best = book.best
    for component in best.components:
        if component.is_formula:
            exchange(best, component, book, context)


def best_of(models: Sequence[Model], book: Book) -> Model | None:
    """Of some models, as the book has them now, the most probable; None of none."""
    k, known = book.overdispersion, [book.models[model.key] for model in models]
    return max(known, key=lambda model: model.score(k), default=None)


def parents(book: Book, size: int) -> list[Model]:
    """The models of a level to extend: the best few that have weight beside the best of them, with either of the kinetics;
    that first which leaves least, since a large overdispersion hides what tells them apart."""
    ranked, k = book.ranked(size), book.overdispersion
    near = [model for model in ranked if model.score(k) >= ranked[0].score(k) - WINDOW]
    names = list(dict.fromkeys(model.names for model in near))[:PARENTS]
    return sorted((model for model in near if model.names in names), key=lambda model: model.fit.squares)


def expand(parent: Model, book: Book, context: SearchContext) -> None:
    """Add to the book what a model may lack one of, fitted; nothing where that was done and it lies where it lay then."""
    known = book.extended.get(parent.key)
    if known is not None and parent.fit.cost > known.cost - WINDOW * book.overdispersion**2:
        return
    taken = {component.plain_name for component in parent.components}
    context.on_progress(f'what {words(parent)} may lack')
    tests = book.tests_of(parent.fit, context)
    proposals = propose.listed(tests, book.catalogue, taken)[:SKETCHED]
    more = propose.differing(parent.fit, parent.names, context) if not parent.leaves_nothing else []
    beginning = [one.component for one in more if one.component.is_of_beginning]  # its promise is of first samples alone
    shared = [one for one in more if not one.component.is_of_beginning][:DIFFERENCES]
    effects = [one.component for one in proposals]
    tried = frozenset(one.name for one in (*effects, *beginning, *(one.component for one in shared)))
    book.extended[parent.key] = Extension(parent.fit.cost, tried, tests.tested)
    found = add_extended(parent, effects, book, context)
    reached = book.reach(len(parent.components) + 1)
    hopeful = [one.component for one in shared if may_reach(parent.fit.cost - one.promise, reached)]
    found += add_extended(parent, [*beginning, *hopeful], book, context)
    if book.explains(found):
        fit_again(parent, found, book, context)


def deepen(parent: Model, book: Book, context: SearchContext) -> None:
    """Fit models with one component more from further starts, where all leave something, and step to what a score test
    passes over."""
    found = book.beside(parent)
    if not book.explains(found):
        fit_again(parent, found, book, context)
    if not (parent.components or parent.leaves_nothing or book.explains(book.beside(parent))):
        add_stepped(parent, book, context, min((one.fit.cost for one in found), default=inf) + WINDOW)


def add_stepped(parent: Model, book: Book, context: SearchContext, reached: float) -> None:
    """Add the effects that score tests have passed over, from a finite step away from neutral."""
    tried = frozenset().union(*(one.tried for (names, _), one in book.extended.items() if names == parent.names))
    taken = {component.plain_name for component in parent.components}
    others = propose.stepped(book.catalogue, tried, taken, book.catalogue.effects)
    found = add_extended(parent, others, book, context, reached)
    fit_again(parent, found, book, context)


def expand_in_other_kinetics(parent: Model, book: Book, context: SearchContext) -> None:
    """Add what the model with the other kinetics led to: what either lacks is alike, only how well it explains is not."""
    size = len(parent.components) + 1
    known = {
        component.name: component
        for model in book.ranked(size)
        if parent.names < model.names and model.key[1] != parent.key[1]
        for component in model.components
        if component.name not in parent.names
    }
    add_extended(parent, list(known.values()), book, context)


def add_extended(
    parent: Model, components: Sequence[Component], book: Book, context: SearchContext, reached: float = inf
) -> list[Model]:
    """Add models with one component more, of those whose sketches come below the cost that others have `reached`."""
    if not components or context.stop.is_set():
        return []
    context.on_progress(f'fitting {", ".join(component.name for component in components)}')
    found = book.add(extended(parent, components, context, reached, target_of(parent, components, book)))
    try_kinetics(book, context)
    for model in found:
        report_model('candidate', model.fit, context)
    return found


def target_of(parent: Model, components: Sequence[Component], book: Book) -> float:
    """The cost below which models with one of some components more have weight: beside all where these are terms, which are
    no step on the way to another model, as effects are."""
    return book.reach(None if any(one.is_formula for one in components) else len(parent.components) + 1)


def fit_again(parent: Model, models: Sequence[Model], book: Book, context: SearchContext) -> None:
    """Fit the best models with one component more from further starts, where all leave something, with either of the
    kinetics: where one leaves nothing with the other ones, those at hand are wrong, in any valley."""
    if not models or context.stop.is_set() or book.explains(models):
        return
    before, target = book.best, target_of(parent, [one.components[-1] for one in models], book)
    book.add(further_fits(parent, models, context, target))
    is_deeper = book.best.names == before.names and book.best.fit.cost < before.fit.cost - SAME_VALLEY
    try_kinetics(book, context, again=is_deeper)


def try_kinetics(book: Book, context: SearchContext, again: bool = False) -> None:
    """The best model with the other kinetics, unless they were tried and it lies (`again`) no deeper since."""
    names = {key[0] for key in book.models if key[1] != book.best.key[1]}
    if book.kinetics and (again or book.best.names not in names) and not context.stop.is_set():
        other = next(one for one in MODELS if one != book.best.key[1])
        book.add([in_other_kinetics(book.best, book.with_one_less(book.best, other), context)])


def add_in_kinetics_of_best(book: Book, context: SearchContext) -> None:
    """The models that have weight with other kinetics than the best one, with its kinetics: what they add to either may be
    right, and the kinetics wrong."""
    tried = set[frozenset[str]]()
    while not context.stop.is_set():
        best, k = book.best, book.overdispersion
        near = (one for one in book.ranked() if one.score(k) >= best.score(k) - WINDOW and one.key[1] != best.key[1])
        model = next((one for one in near if one.names not in tried and (one.names, best.key[1]) not in book.models), None)
        if model is None:
            return
        tried.add(model.names)
        book.add([in_other_kinetics(model, book.with_one_less(model, best.key[1]), context)])


def improve(size: int, book: Book, context: SearchContext) -> None:
    """Exchange or drop each component of the best model of a level, if it has weight, as long as that leads further; of one
    that leaves nothing where it is the best of all or tied with that."""
    for _ in range(ROUNDS if book.ranked(size) else 0):
        improve_forms(size, book, context)
        best = best_with_weight(size, book)
        if best is None or (best.leaves_nothing and not is_tied(best, book)):
            return
        for component in best.components:
            (exchange_difference if component.is_difference else exchange)(best, component, book, context)
        if context.stop.is_set() or book.ranked(size)[0] is best:
            return


def is_tied(model: Model, book: Book) -> bool:
    """Whether a model is about as probable as the best."""
    k = book.overdispersion
    return model.score(k) >= book.best.score(k) - TIE


def best_with_weight(size: int, book: Book) -> Model | None:
    """The best model of a level, if it has weight beside the best of all."""
    best, k = next(iter(book.ranked(size)), None), book.overdispersion
    return best if best is not None and best.score(k) >= book.best.score(k) - WINDOW else None


def improve_forms(size: int, book: Book, context: SearchContext) -> None:
    """The best model of a level with the law of one of its effects in another form."""
    best = best_with_weight(size, book)
    if best is not None and not best.leaves_nothing:
        add_forms(best, book, context)


def improve_without(best: Model, book: Book, context: SearchContext) -> None:
    """A model without one of its effects that explains little beside the others, with the law of one of these in another
    form: that may be all which the former has mended."""
    k = book.overdispersion
    for component in best.of_robot:
        rest = book.find(best.names - {component.name})
        if rest is not None and rest.components and best.score(k) - rest.score(k) < IMITATED:
            add_forms(rest, book, context)


def add_forms(model: Model, book: Book, context: SearchContext) -> None:
    """A model with the law of one of its effects in another form."""
    for law, form in propose.forms(model, book.catalogue, context)[:FORMS] if not context.stop.is_set() else ():
        add_extended(stripped(model, (law,)), [form], book, context)


def exchange(best: Model, component: Component, book: Book, context: SearchContext) -> None:
    """Models with another component in place of one, proposed where the parameters of the best one lie: nearer to the true
    ones than those of any model without it. Models that were fitted from elsewhere and ended far behind are tried again."""
    if component.is_difference or context.stop.is_set():
        return
    context.on_progress(f'what may stand in place of {component.name}')
    base = stripped(best, (component,))
    known = book.models.get((base.names, best.key[1]))
    worth = 0.0 if known is None else EXCHANGE_SHARE * (known.fit.squares - best.fit.squares)
    ways = propose.in_place(book.tests_of(best.fit, context), book.catalogue, component, base, worth)
    if base.components or ways[0].own < WINDOW / EXCHANGE_SHARE:
        book.add([without(best, component, context)])
    k = book.overdispersion
    near = {model.names for model in book.models.values() if model.score(k) > best.score(k) - WINDOW}
    hopeful = [[one.component for one in way.others if one.promise >= EXCHANGE_SHARE * way.own] for way in ways]
    in_turn = [one for some in zip_longest(*hopeful) for one in some if one and base.names | {one.name} not in near]
    by_name = dict[str, Component]()
    for one in in_turn:
        by_name.setdefault(one.name, one)
    add_extended(base, list(by_name.values())[:SKETCHED], book, context)


def exchange_difference(best: Model, component: Component, book: Book, context: SearchContext) -> None:
    """Models with an effect in place of what differs between the recordings: where these heat or cool differently, either
    imitates the other, and only both together may lead to it."""
    if context.stop.is_set():
        return
    context.on_progress(f'which effect may stand in place of {component.name}')
    base = without_difference(best, component, book.ranked(0)[0].fit.problem)
    taken = {one.plain_name for one in base.components}
    proposals = propose.listed(book.tests_of(base.fit, context), book.catalogue, taken)
    add_extended(base, [one.component for one in proposals[:SKETCHED]], book, context)


def words(model: Model) -> str:
    """What progress calls a model."""
    return ' + '.join(component.name for component in model.components) or 'the nominal model'
