"""Laws: formulas that diagnosis proposed, or users wrote, as effects of the model.

A formula is text of a closed grammar (`grammar`): it is data, and nothing of it is ever run as Python that somebody
wrote. `words` lists what a formula may say, `units` what unit each part has, `places` where in the model a law acts,
`tree` is what a formula becomes, `law` what a law is; `effect` makes of it an entry as any other, whose equations
`statements` writes.
"""

from cmr.model.laws.law import Law as Law
