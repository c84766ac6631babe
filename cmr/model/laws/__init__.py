"""Laws: formulas proposed by diagnosis, or written by users, as effects of the model.

A formula is text of a closed grammar (`grammar`): it is data, and never executed as Python. `words` lists the variables
and functions of formulas, `units` checks units, `places` are the places in the model where laws act, `tree` is a parsed
formula, `law` a law; `effect` turns it into a normal entry, with equations from `statements`.
"""

from cmr.model.laws.law import Law as Law
